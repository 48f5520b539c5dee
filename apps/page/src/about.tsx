// Where it all comes from: versions, command, machine, scenes, metrics, parameters.
import { usePage } from "./context";
import { number } from "./format";
import { ScrollTable, Section } from "./controls";
import { listed, settingOf } from "./results";

export function About() {
  const { index, view } = usePage();
  const { results } = index;
  const machine = typeof results.machine === "string" ? results.machine : results.machine?.cpu;
  const threads = typeof results.machine === "object" ? results.machine.threads : undefined;
  const { file, ...settings } = results.experiment ?? {};
  const edges = (id: string) => index.row(view.scene, view.spp, id, "frame")?.at_the_edge ?? [];
  const facts: [string, string | undefined][] = [
    ["brume", results.brume],
    ["Commit", results.commit],
    ["Command", results.command],
    ["Machine", machine],
    ["Threads", threads === undefined ? undefined : String(threads)],
    ["Samples per pixel", results.spp.join(", ")],
    ["Seeds", results.seeds?.join(", ")],
  ];
  return (
    <div class="about">
      <Section title="This evaluation">
        <dl class="facts">
          {facts.map(([name, value]) =>
            value ? (
              <>
                <dt>{name}</dt>
                <dd>{name === "Command" || name === "Commit" ? <code>{value}</code> : value}</dd>
              </>
            ) : null,
          )}
        </dl>
      </Section>
      <Section title="Scenes">
        <ScrollTable
          label="Scenes"
          class="metrics text"
          columns={[
            "Scene",
            "Size",
            "Medium",
            "References",
            "Noise of one, of their mean, Lab RMS",
            "Exposure",
            "Hash",
          ]}
        >
          {results.scenes.map((s) => (
            <tr key={s.name}>
              <th scope="row">{s.name}</th>
              <td>{s.width && s.height ? `${s.width}\u00a0×\u00a0${s.height}` : "–"}</td>
              <td>{s.medium_share === undefined ? "–" : `${(100 * s.medium_share).toFixed(1)} % of the pixels`}</td>
              <td>{s.reference_spp === undefined ? "–" : `${s.references ?? 2} × ${s.reference_spp} spp`}</td>
              <td>
                {s.references === 1
                  ? "unknown"
                  : `${number(s.reference_noise)}, ${number(s.reference_errors?.frame?.["lab_rms"])}`}
              </td>
              <td>{s.exposure ?? "–"}</td>
              <td>
                <code>{s.hash ?? "–"}</code>
              </td>
            </tr>
          ))}
        </ScrollTable>
      </Section>
      {results.metrics.length > 0 && (
        <Section title="Metrics">
          <dl class="definitions">
            {results.metrics.map((m) => (
              <>
                <dt>
                  {m.name} <small>{m.better === "zero" ? "closer to 0 is better" : `${m.better} is better`}</small>
                </dt>
                <dd>{m.definition || "—"}</dd>
              </>
            ))}
          </dl>
        </Section>
      )}
      <Section
        title="Methods and their parameters"
        note={`Of ${view.scene} at ${view.spp} spp. A searched value at the edge of what was tried is marked: the best may lie further out.`}
      >
        <ScrollTable
          label="Methods and their parameters"
          class="metrics text"
          columns={["Method", "Parameters", "Features"]}
        >
          {results.methods.map((m) => (
            <tr key={m.id} data-method={m.id}>
              <th scope="row">
                {m.label}
                {settingOf(m) && <small> {settingOf(m)}</small>}
              </th>
              <td>
                {m.command && <code class="parameter">{m.command}</code>}
                {index.parameters(view.scene, view.spp, m.id).map(([name, value]) => (
                  <code key={name} class="parameter">
                    {name}
                    {value && <b>{value}</b>}
                    {edges(m.id).includes(name) && <span class="edge"> at the edge</span>}
                  </code>
                ))}
              </td>
              <td>
                {listed(m.features).map(([name, value]) => (
                  <code key={name} class="parameter">
                    {name}
                    {value && <b>{value}</b>}
                  </code>
                ))}
              </td>
            </tr>
          ))}
        </ScrollTable>
      </Section>
      {results.experiment && (
        <Section title="Experiment">
          <pre tabIndex={0}>{JSON.stringify(settings, undefined, 2)}</pre>
          {file && (
            <>
              <h3>Its file</h3>
              <pre tabIndex={0}>{file}</pre>
            </>
          )}
        </Section>
      )}
      <Section
        title="About the pictures"
        note="References, noisy and filtered frames of the first seed, as half floats: 11 bits of precision, which the values under the pointer and the error maps inherit. Errors are taken against the mean of the references, after the scene's exposure; the tables come from the frames themselves, with the references' noise taken off."
      />
    </div>
  );
}
